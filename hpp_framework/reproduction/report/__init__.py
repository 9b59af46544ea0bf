"""The report of a reproduction: one page that opens from disk and needs nothing but itself."""

from hpp_framework.reproduction.report.page import write_report

__all__ = ["write_report"]
