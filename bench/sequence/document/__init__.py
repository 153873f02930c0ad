"""Sequence files as documents: model, schema, starter file."""
