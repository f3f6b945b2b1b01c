"""A campaign rehearsed: simulated instruments on pseudo-terminals, a phone behind a shell, one air for all."""
