"""Common halves of drivers of one kind: chambers, heads, tables, sources, frame sources."""
