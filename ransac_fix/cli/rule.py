"""``ransac-fix rule``: what a rule finds, why, and what to write instead."""

import click


@click.command()
@click.argument("code")
def command(code: str) -> None:
    """Explain one rule, by its code (RFX001) or its name."""
    from ransac_fix.report.rule_text import rule_text
    from ransac_fix.scan.rules import find_rule

    click.echo(rule_text(find_rule(code)), nl=False)
