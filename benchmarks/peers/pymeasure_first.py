"""A procedure of PyMeasure with one row in a CSV file, which says that it begins."""

import tempfile
from pathlib import Path

from pymeasure.experiment import Procedure, Results, Worker


class First(Procedure):
    DATA_COLUMNS = ("value",)

    def execute(self):
        print("begins", flush=True)
        self.emit("results", {"value": 1.0})


with tempfile.TemporaryDirectory() as folder:
    worker = Worker(Results(First(), str(Path(folder, "rows.csv"))))
    worker.start()
    worker.join(timeout=60)
