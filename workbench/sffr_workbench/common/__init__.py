"""What several rooms share: numbers and tables for people, HTML, progress, optional packages, origin of results."""

from sffr_workbench.common.backends import Backend, WorkersLost
from sffr_workbench.common.extras import is_missing, require
from sffr_workbench.common.html import png_uri, template
from sffr_workbench.common.names import file_name
from sffr_workbench.common.numbers import format_error, format_number, plural, prefixed_unit
from sffr_workbench.common.origin import describe_commit, describe_versions
from sffr_workbench.common.processes import end_with_parent, interrupts_ignored
from sffr_workbench.common.progress import Progress, ignore
from sffr_workbench.common.tables import markdown_table, terminal_table

__all__ = [
    "Backend",
    "Progress",
    "WorkersLost",
    "describe_commit",
    "describe_versions",
    "end_with_parent",
    "file_name",
    "format_error",
    "format_number",
    "ignore",
    "interrupts_ignored",
    "is_missing",
    "markdown_table",
    "plural",
    "png_uri",
    "prefixed_unit",
    "require",
    "template",
    "terminal_table",
]  # fmt: skip
