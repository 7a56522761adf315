"""Reports: HTML page and terminal summary of a diagnosis, recordings for the rerun viewer, runs as CSV."""

from twin.report.html import write_report
from twin.report.text import print_summary, summary

__all__ = ["print_summary", "summary", "write_report"]
