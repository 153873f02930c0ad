"""A thermometer that nobody makes, to start from: a driver, its description and its simulator."""
