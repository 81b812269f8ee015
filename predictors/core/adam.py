"""Training of a network's layers by Adam, in JAX and Optax."""

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np

from ...framework.values.arrays import Array

BATCH = 512
"""Windows per update."""
UPDATES = 50
"""Updates per round; after each round the held-out windows are looked at."""
RATE = 3e-3
"""Largest learning rate; it falls to 0 as a half cosine."""
DECAY = (0.9, 0.999)
"""Memory of Adam's two averages."""
Layers: TypeAlias = list[tuple[Any, Any]]
"""Pairs of weight and bias."""
Program: TypeAlias = tuple[Callable[..., Any], Callable[..., Any]]
"""A compiled round of training, and the compiled losses."""


def compiled(losses: Callable[..., Any]) -> Program:
    """Compile a round of Adam, and the losses of held-out windows.

    Parameters
    ----------
    losses : (layers, sizes, *parts of the windows) -> (W,); the mean is lowered.
    """
    import jax
    import jax.numpy as jnp
    import optax

    slope = jax.grad(lambda *given: losses(*given).mean())
    adam = optax.scale_by_adam(*DECAY)

    def update(state: Any, batch: Any) -> tuple[Any, None]:
        layers, memory, sizes, total = state
        updated: Any = adam.update(slope(layers, sizes, *batch), memory)
        step, memory = updated
        rate = 0.5 * RATE * (1 + jnp.cos(jnp.pi * memory.count / total))
        layers = jax.tree.map(lambda p, s: p - rate * s, layers, step)
        return (layers, memory, sizes, total), None

    def round_of(state: Any, *batches: Any) -> Any:
        return jax.lax.scan(update, state, batches)[0]

    return jax.jit(round_of), jax.jit(losses)


def descend(
    program: Callable[[], Program],
    layers: Layers,
    sizes: Any,
    draw: Callable[[int], Sequence[Array]],
    held: Sequence[Array],
    worth: Array,
    rounds: int,
) -> Layers:
    """Return the layers of the round with the lowest held-out loss.

    Parameters
    ----------
    program : gives what `compiled` returns.
    layers : to begin with, float32.
    sizes : handed to the losses.
    draw : gives the parts of so many windows, float32.
    held : parts of the held-out windows. worth : (W,), their weights.
    rounds : of `UPDATES` updates each.
    """
    import jax
    import optax

    with jax.enable_x64(False):
        round_of, held_losses = program()
        memory = optax.scale_by_adam().init(layers)
        state = layers, memory, sizes, np.float32(rounds * UPDATES)
        best, kept = np.inf, layers
        for _ in range(rounds):
            drawn = draw(UPDATES * BATCH)
            batches = [part.reshape(UPDATES, BATCH, *part.shape[1:]) for part in drawn]
            state = round_of(state, *batches)
            reached = float(np.dot(worth, np.asarray(held_losses(state[0], sizes, *held))))
            if reached < best:
                best, kept = reached, state[0]
    return [(np.asarray(weight), np.asarray(bias)) for weight, bias in kept]
