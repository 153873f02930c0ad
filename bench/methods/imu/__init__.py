"""Method M2: an inertial unit in 24 attitudes over temperature."""
