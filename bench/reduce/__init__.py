"""From a stored run to results: acquisitions, certificates, evaluation, verification."""
