"""``sffr report``: runs as one page that needs no network, with a replay of an episode of each policy."""

from sffr_workbench.report.page import REPORT_FILE, report_page, write_report
from sffr_workbench.report.runs import Run, read_run

__all__ = ["REPORT_FILE", "Run", "read_run", "report_page", "write_report"]
