"""Reference pages, generated from the models."""
