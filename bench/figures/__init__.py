"""Figures, numbers and words as every page uses them."""
