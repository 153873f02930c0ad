"""A fictitious thermal chamber to start from: driver, description and simulator."""
