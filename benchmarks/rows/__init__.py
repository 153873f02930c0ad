"""The rows of the table: each module measures one work, by `measure(whole)`, and yields its rows.

`whole` is true in `make benchmark-full`: nights instead of slices of them.
"""
