"""Kinds of `bench campaign` that need the sources: results against their truth, and faults on lines and buses."""
