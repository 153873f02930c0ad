"""An indexing head that a person turns: no wire, a question for each move and an angle typed in answer."""
