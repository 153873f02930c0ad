"""A fictitious pulse counter to start from: driver, description and simulator."""
