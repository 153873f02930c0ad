"""Bench files: strictly parsed YAML documents, validated into models."""
