"""A fictitious thermometer to start from: driver, description and simulator."""
