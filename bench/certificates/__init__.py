"""Digital Calibration Certificates (DCC) of the PTB: units, safe reading, signatures."""
