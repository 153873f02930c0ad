"""Field types and messages of documents: bench files, sequences, cases."""
