"""Positioning axes behind a Newport XPS controller, over its TCP port."""
