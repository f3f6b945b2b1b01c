"""The thesis's evaluation, run again on a simulated phone and put beside what was published."""
