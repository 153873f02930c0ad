"""View of all benches of all stations, from what these publish to a broker.

`facts` reads messages, `fold` keeps what was received, `cards` is what is shown of it, `broker` subscribes, `history`
asks an archive of runs, `pages` and `server` show it. It publishes nothing and commands nothing.
"""
