"""Methods M4a and repeatability: static tumbles over temperature, remountings and power cycles."""
