"""Sequences: from YAML to a checked plan. Pure: nothing is opened and nothing moves."""
