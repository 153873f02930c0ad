"""Figures, numbers and words common to all pages."""
