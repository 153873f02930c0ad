"""Positioning axes behind an Aerotech Ensemble controller, over its ASCII port."""
