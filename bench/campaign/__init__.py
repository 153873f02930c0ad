"""Campaigns: many independent nights or reductions, by processes of this computer or by a cluster of dask.distributed.

`tasks` and `ledger` are what is done and what is known, `cluster` and `carry_out` who does it, `work` the side of a
worker; `nights` and `reductions` are kinds, further ones are in the folder `campaigns` of the sources.
"""
