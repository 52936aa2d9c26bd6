"""``sffr report``: runs as one page that needs no network, with a replay of an episode of each policy."""
