"""Program that sends one message to one address, as `python -m bench.station.alerts.send`.

The address, the title and the text come on standard input, since the words of a command are seen by all users. The
answer on standard output is the problem, or nothing.
"""

from __future__ import annotations

import json
import logging
import re
import signal
import sys
from urllib.parse import unquote, urlsplit

LIMIT_S = 30
SHOWN = 200  # characters of a problem
_MASK = "***"


class _Kept(logging.Handler):
    """Handler that keeps the messages of a library."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a message."""
        self.lines.append(record.getMessage())


def send(url: str, title: str, body: str) -> str:
    """Send a message; return the problem without the secrets of the address, or ""."""
    try:
        import apprise
    except ImportError as problem:
        return f"alerts need more packages ({problem}): pip install 'inertial-test-bench[station]'"
    kept, log = _Kept(), logging.getLogger("apprise")
    log.addHandler(kept)
    log.propagate = False
    sender = apprise.Apprise(asset=apprise.AppriseAsset(async_mode=False, app_id="Inertial test bench"))
    if not sender.add(url):
        return "the address is none that apprise knows; look at the list of its services"
    if sender.notify(body=body, title=title, body_format=apprise.NotifyFormat.TEXT, interpret_escapes=False):
        return ""
    return masked(" ".join(kept.lines) or "the service has refused it", url)[:SHOWN]


def masked(text: str, url: str) -> str:
    """Return a text in one line in which no secret of an address appears."""
    parts = urlsplit(url)
    secrets = {url, parts.username, parts.password, parts.path, parts.query, *parts.path.split("/")}
    secrets |= {value for pair in parts.query.split("&") for value in (pair, pair.partition("=")[2])}
    secrets |= {unquote(each) for each in secrets if each}
    if "." not in parts.netloc:  # many services have a token in place of the host
        secrets |= {parts.netloc, *parts.netloc.rpartition("@")[2].split(":")}
    for secret in sorted((each for each in secrets if each and len(each) > 2), key=len, reverse=True):
        text = text.replace(secret, _MASK)
    return re.sub(r"\s+", " ", text).strip()


def main() -> None:
    """Send what standard input has."""
    signal.alarm(LIMIT_S)  # also where the station that would end it has died
    asked = json.loads(sys.stdin.read())
    sys.stdout.write(send(asked["url"], asked["title"], asked["body"]))


if __name__ == "__main__":
    main()
