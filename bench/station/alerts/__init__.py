"""Alerts of a station: what happened, sent to people by mail, chat or webhook, until somebody acknowledges it.

`watch` and `rounds` find causes, `table` makes each an alert on the disk, `route` sends it, `words` has its texts.
"""
