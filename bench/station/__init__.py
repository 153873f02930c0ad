"""Station: one computer with its benches, the queue of their runs, and what people and programs see of them.

It opens no instrument. Each run is a process of its own, which goes on when the station ends.
"""
