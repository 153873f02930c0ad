"""Queue of a station: its items, their order, and the processes that run them.

`table` keeps items on the disk, `schedule` orders them, `scheduler` begins and ends them, each by `attempts` at a run;
`resuming` continues a run that was interrupted.
"""
