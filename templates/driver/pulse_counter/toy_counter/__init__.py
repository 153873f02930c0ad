"""A pulse counter that nobody makes, to start from: a driver, its description and its simulator."""
