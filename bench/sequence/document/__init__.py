"""A sequence file as a document: its parts, its schema, a file to start from."""
