"""The workbench: the command line and what it makes; ``evaluate`` for programs and notebooks."""

from typing import TYPE_CHECKING, Any

__all__ = ["Evaluation", "evaluate"]

if TYPE_CHECKING:
    from sffr_workbench.evaluation import Evaluation, evaluate
else:

    def __getattr__(name: str) -> Any:
        """Import evaluation at its first use; the command line begins without it."""
        if name not in __all__:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from sffr_workbench import evaluation

        return getattr(evaluation, name)
