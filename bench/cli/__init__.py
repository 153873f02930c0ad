"""The command line: parses, calls the application, prints, and sets the exit code."""
