"""Climatic chambers and their controllers."""
