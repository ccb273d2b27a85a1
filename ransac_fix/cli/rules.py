"""``ransac-fix rules``: every rule in one line each."""

import click


@click.command()
def command() -> None:
    """List the rules of the scan."""
    from ransac_fix.report.rule_text import rules_text
    from ransac_fix.scan.rules import all_rules

    click.echo(rules_text(all_rules()), nl=False)
