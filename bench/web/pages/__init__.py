"""Pages of a station. They work without JavaScript as far as reading goes, and contain no inline script or style."""
