"""Heads and rate tables that speak in frames of fixed length, as a file describes them."""
