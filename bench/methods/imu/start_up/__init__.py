"""Start-up of a compensated inertial unit after power-on."""
