"""Reference pages, made from the models: what may be written in files, and what the program answers."""
