"""Reduction of a stored run to results: acquisitions, certificates, evaluation, verification."""
