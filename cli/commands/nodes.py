"""The command `calib nodes`."""

from __future__ import annotations

from typing import Annotated

from .. import options as o
from ..usage import option


def nodes(
    model: o.ModelArgument,
    output: Annotated[
        str,
        option(
            "--output -o FILE", "A CSV or, by its ending, Parquet file (default standard output)."
        ),
    ] = "-",
) -> None:
    """List the nodes of the motor map: joint values, positions, 95 % bounds [rad, m].

    The bounds are those of `calib query`; nan where no sample visited a node.
    """
    import numpy as np

    import calib
    from calib.samples.tables import write_table

    loaded = calib.load(model)
    about, q, seen = loaded.about, loaded.motor.weights, loaded.visited
    columns = {
        **dict(zip(about.joint_names, q.T, strict=True)),
        **dict(zip(loaded.axes, loaded.forward(q).T, strict=True)),
        "expected_error": np.where(seen, loaded.bounds, np.nan),
        "model_error": np.where(seen, loaded.model_bounds, np.nan),
    }
    write_table(output, columns, about={"unit": about.unit})
