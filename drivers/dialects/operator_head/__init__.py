"""An indexing head turned by hand: no wire, an operator prompt for each move, answered with an angle."""
