"""``collect --simulate``: instruments on pseudo-terminals, a phone behind a shell, and one air for all of them."""
