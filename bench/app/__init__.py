"""Application: combines a bench file and a sequence into a run; the only importer of the simulators."""
