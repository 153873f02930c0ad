"""`python -m campaigns.flights`."""

import sys

from campaigns.flights.fleet import main

if __name__ == "__main__":
    sys.exit(main())
