"""Steps a second of a workflow of DBOS on SQLite, each kept before the next begins: COUNT, and how SQLite is set."""

import json
import logging
import sys
import tempfile
import time
from pathlib import Path

import sqlalchemy
from dbos import DBOS

logging.disable(logging.CRITICAL)
settings: dict[str, object] = {}


@sqlalchemy.event.listens_for(sqlalchemy.Engine, "commit")
def look(connection: sqlalchemy.Connection) -> None:
    """Note once how the connection that commits is set."""
    if not settings and connection.dialect.name == "sqlite":
        cursor = connection.connection.cursor()
        for name in ("journal_mode", "synchronous"):
            settings[name] = cursor.execute(f"PRAGMA {name}").fetchone()[0]


@DBOS.step()
def step(number: int) -> int:
    """Nothing."""
    return number


@DBOS.workflow()
def flow(count: int) -> None:
    """So many steps."""
    for number in range(count):
        step(number)


asked = int(sys.argv[1])
with tempfile.TemporaryDirectory() as folder:
    database = f"sqlite:///{Path(folder).absolute()}/dbos.sqlite"
    DBOS(config={"name": "steps", "system_database_url": database, "log_level": "CRITICAL", "run_admin_server": False})
    DBOS.launch()
    flow(2)
    began_s = time.perf_counter()
    flow(asked)
    took_s = time.perf_counter() - began_s
    DBOS.destroy()
print(json.dumps({"steps_per_s": asked / took_s, **settings}))
