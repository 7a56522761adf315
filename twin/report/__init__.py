"""What a person reads of a diagnosis: a page (`html`) and a summary for the terminal (`text`)."""

from twin.report.html import write_report
from twin.report.text import print_summary, summary

__all__ = ["print_summary", "summary", "write_report"]
