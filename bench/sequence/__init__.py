"""Sequences: YAML into a checked plan. Everything here is pure; nothing is opened, nothing moves."""
