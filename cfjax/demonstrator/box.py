"""Small dense programs, unrolled and without LAPACK, so that a whole batch goes through them side by side.

Vectors are arrays (m, k), matrices (m, m, k): the batch comes last. Three or four inputs, so every sum is written out.

**What is fused is said here.** XLA on CPUs fuses what is computed from one another as far as it can, and computes again
in each kernel what several of them use: unrolled chains of small matrices, where everything is used often, cost
thousands of times their arithmetic then (measured: 3.8 ms for what takes 1 µs). `keep` marks what is to be computed
once and stored; between such marks fusion is welcome. The marks hold only with `COMPILER`, for XLA takes them out
before it fuses.
"""

from typing import Final

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float


COMPILER: Final[dict[str, bool | int | float | str]] = {"xla_disable_hlo_passes": "cse_barrier_expander"}  # keep `keep`

keep = jax.lax.optimization_barrier


def product(a: Float[Array, "p q #k"], b: Float[Array, "q r #k"]) -> Float[Array, "p r #k"]:
    return sum((a[:, i, None] * b[None, i] for i in range(1, a.shape[1])), start=a[:, 0, None] * b[None, 0])


def transposed(a: Float[Array, "p q #k"]) -> Float[Array, "q p #k"]:
    return jnp.swapaxes(a, 0, 1)


def applied(a: Float[Array, "p q #k"], x: Float[Array, " q #k"]) -> Float[Array, " p #k"]:
    return sum((a[:, i] * x[i][None] for i in range(1, a.shape[1])), start=a[:, 0] * x[0][None])


def dot(x: Float[Array, " q #k"], y: Float[Array, " q #k"]) -> Float[Array, " #k"]:
    return sum((x[i] * y[i] for i in range(1, x.shape[0])), start=x[0] * y[0])


def factor(h: Float[Array, "m m k"]) -> list[list[Array]]:
    """H = L D Lᵀ of a positive definite H, by rows: L, and 1/D where its diagonal would be."""
    table: list[list[Array]] = []
    for j in range(h.shape[0]):
        times_pivot: list[Array] = []  # L_ji D_i
        for i in range(j):
            times_pivot.append(h[j, i] - sum(times_pivot[p] * table[i][p] for p in range(i)))
        row = [entry * table[i][i] for i, entry in enumerate(times_pivot)]
        pivot = h[j, j] - sum(a * b for a, b in zip(row, times_pivot, strict=True))
        table.append(list(keep((*row, 1.0 / pivot))))
    return table


def solve(table: list[list[Array]], b: list[Array]) -> list[Array]:
    """x with H x = b from the factors of H; the entries of b may be arrays (…, k)."""
    each, rank = range(len(b)), b[0].ndim
    table = [[entry.reshape((1,) * (rank - 1) + (-1,)) for entry in row] for row in table]
    x: list[Array] = []
    for i in each:
        x.append(keep(b[i] - sum(table[i][p] * x[p] for p in range(i))))
    x = [x[i] * table[i][i] for i in each]
    for i in reversed(each):
        x[i] = keep(x[i] - sum(table[p][i] * x[p] for p in each[i + 1 :]))
    return x


def without(h: Float[Array, "m m k"], held: Bool[Array, "m k"]) -> Float[Array, "m m k"]:
    """H without the rows and columns of held entries, each replaced by a one on the diagonal."""
    unit = jnp.eye(h.shape[0])[:, :, None]
    return keep(jnp.where(held[:, None] | held[None, :], unit, h))


def smallest_in_box(
    h: Float[Array, "m m #k"], q: Float[Array, " m #k"], lower: Float[Array, " m #k"], upper: Float[Array, " m #k"]
) -> tuple[Float[Array, " m #k"], Bool[Array, " m #k"]]:
    """A point d of the box with a low ½ dᵀHd + qᵀd, and which of its entries are held by the box.

    H is positive definite and 0 lies in the box. Projected Newton steps from 0 (Tassa, Mansard and Todorov 2014,
    section III), as many as there are entries: each goes to the better of two points, the full step clipped into the
    box, or the step cut where it meets the box's first face. The cut one never ascends, and takes up a face. Nearly
    always this ends at the minimiser; where faces have to be left again (a few programs in a hundred, of random ones)
    it ends above it, but never above 0, and the next iteration goes on from there.
    """

    def judged(d: Array) -> tuple[Array, Array]:
        g = q + applied(h, d)
        held = ((d <= lower) & (g > 0)) | ((d >= upper) & (g < 0)) | (upper <= lower)
        return keep(g), held

    d = jnp.zeros_like(q)
    g, held = judged(d)
    for _ in range(q.shape[0]):
        rest = jnp.where(held, 0.0, -g)
        s = jnp.stack(solve(factor(without(h, held)), list(rest)))
        full = keep(jnp.clip(d + s, lower, upper))
        room = jnp.where(s > 0, upper - d, lower - d)
        share = keep(jnp.where(jnp.abs(s) > jnp.abs(room), room / jnp.where(s == 0, 1.0, s), 1.0))
        least = jnp.min(share, axis=0, keepdims=True)
        cut = keep(jnp.where(share <= least, full, jnp.clip(d + least * s, lower, upper)))

        def value(d: Array) -> Array:
            return dot(d, q + 0.5 * applied(h, d))

        d = keep(jnp.where((value(full) <= value(cut))[None], full, cut))
        g, held = judged(d)
    return d, held
