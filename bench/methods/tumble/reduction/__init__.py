"""Reduction of dwells to bias, scale factor, K2 and misalignment over temperature."""
