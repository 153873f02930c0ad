"""Indexing heads and rate tables."""
