"""``sffr reproduce``: the figures of the paper's section 5.3 with our numbers, and what became of its claims."""

from agents.reproduce.page import table as claims_table
from agents.reproduce.page import verdicts
from agents.reproduce.run import CLAIMS, reproduce

__all__ = ["CLAIMS", "claims_table", "reproduce", "verdicts"]
