"""Puts the parts together: a bench file and a sequence become a run; the only importer of the simulators."""
