"""Multimeters and scanners."""
