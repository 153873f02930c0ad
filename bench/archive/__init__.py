"""Archive of runs for several benches: a folder or a bucket with their files, and Delta tables of their results.

`destination` is the store, `rows` and `columns` what the tables hold, `publish` writes a run, `query` reads with SQL.
The libraries are those of the extra `archive`; they are imported when an archive is opened.
"""
