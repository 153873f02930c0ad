"""Mutants of the code that safety and records stand on: which of them the tests notice."""
