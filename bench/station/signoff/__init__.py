"""Sign-off: a second person decides about a sealed run; an approval issues its report."""
