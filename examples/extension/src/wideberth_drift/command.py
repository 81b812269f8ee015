"""Print how far people drift."""

import typer

app = typer.Typer(add_completion=False)


@app.command()
def drift(speed: float, time: float = 3.0) -> None:
    """Print how far people drift."""
    typer.echo(f"{speed * time:.2f} m")
