"""Bench files: YAML documents, strictly read, into models."""
