"""``sffr reproduce``: the figures of the paper's section 5.3 with our numbers, and what became of its claims."""

from sffr_workbench.reproduce.page import claims_table, verdicts
from sffr_workbench.reproduce.run import CLAIMS_FILE, reproduce

__all__ = ["CLAIMS_FILE", "claims_table", "reproduce", "verdicts"]
