"""Findings on the terminal and in the log."""

from spherecal.base.messages.catalogue import language
from spherecal.data.findings import Finding
from spherecal_app.cli.console import out, say
from spherecal_app.cli.progress import log

_COLOUR = {"error": "red", "warning": "yellow", "info": "blue"}


def show_findings(findings: tuple[Finding, ...]) -> None:
    """Print each, with its severity in colour."""
    for finding in findings:
        out.print(f"[{_COLOUR[finding.severity]}]{finding.severity}[/] {finding.code}: ", end="")
        message, hint = (finding.words(part, language()) for part in ("message", "hint"))
        say(f"{message} {hint}".strip())


def log_findings(findings: tuple[Finding, ...]) -> None:
    """Write each into the log."""
    for finding in findings:
        log.info("finding: %s %s: %s", finding.severity, finding.code, finding.message)
