"""The report: one self-contained HTML page about a recording, its interaction and its transfers."""

from icjax.report._write import Report as Report
from icjax.report._write import write_report as write_report
