"""Recognising an unknown instrument with questions that change nothing."""
