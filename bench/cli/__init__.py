"""Command line: parses arguments, calls the application, prints, and sets the exit code."""
