"""Speed, beside its lower bounds."""
