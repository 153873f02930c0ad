"""Draw docs/images/report.png, a part of the report of `make demo`: `.venv/bin/python docs/images/draw_report.py`.

Chromium lays the page out; Pillow, which comes with matplotlib, makes the file small.
"""

import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
SIZE_PX = (1000, 1040)
SHOWN = """
<style>
section, dl.facts { display: none }
#verdicts, #course { display: block }
body { zoom: 0.9 }
</style>
</head>"""


def run(runs: Path) -> Path:
    """Run what `make demo` runs; its report."""
    words = ["run", "sequences/tumble_static.yaml", "--bench", "config/simulated.yaml", "--operator", "demo"]
    subprocess.run(
        [sys.executable, "-m", "bench", *words, "--uut", "QF-0001", "--runs", str(runs)], cwd=ROOT, check=True
    )
    (report,) = runs.glob("*/report.html")
    return report


def photograph(page: Path, picture: Path) -> None:
    """Write what a window of Chromium shows of a page."""
    quiet = ["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--no-first-run"]
    size = f"--window-size={SIZE_PX[0]},{SIZE_PX[1]}"
    profile = f"--user-data-dir={picture.parent / 'profile'}"
    command = ["chromium", *quiet, profile, size, f"--screenshot={picture}", page.as_uri()]
    subprocess.run(command, capture_output=True, check=True)


def main() -> None:
    """Run, photograph, reduce the colours."""
    with TemporaryDirectory() as folder:
        report = run(Path(folder) / "runs")
        page = report.with_name("shown.html")
        page.write_text(report.read_text("utf-8").replace("</head>", SHOWN, 1), "utf-8")
        picture = Path(folder) / "picture.png"
        photograph(page, picture)
        Image.open(picture).convert("RGB").quantize(128).save(HERE / "report.png", optimize=True)


if __name__ == "__main__":
    main()
