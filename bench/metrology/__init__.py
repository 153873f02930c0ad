"""Arithmetic shared by the methods: counts, fits, uncertainty, orientation. numpy arrays in, frozen dataclasses out."""
