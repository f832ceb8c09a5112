"""Small networks in OpenVINO's own format."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import ArrayLike

_TYPES = {"float16": "f16", "int64": "i64", "uint64": "u64"}


@dataclass
class Ir:
    """A network that grows by one layer at a time; a layer is the number that :meth:`layer` returned for it."""

    layers: list[str] = field(default_factory=list)
    edges: list[str] = field(default_factory=list)
    shapes: list[Sequence[int]] = field(default_factory=list)
    content: bytes = b""

    def layer(
        self, kind: str, *inputs: int, shape: Sequence[int] = (), name: str | None = None, **attributes: object
    ) -> int:
        """Add a layer that takes the outputs of others and gives one of this shape."""
        number = len(self.layers)
        given = "".join(f" {key.rstrip('_')}={quoteattr(str(value))}" for key, value in attributes.items())
        ports = "".join(_port(place, self.shapes[source]) for place, source in enumerate(inputs))
        output = "" if kind == "Result" else f"<output>{_port(len(inputs), shape, name)}</output>"
        self.layers.append(
            f'<layer id="{number}" name={quoteattr(name or f"{kind} {number}")} type="{kind}" version="opset1">'
            f"<data{given}/><input>{ports}</input>{output}</layer>"
        )
        for place, source in enumerate(inputs):
            port = self.layers[source].partition("<output>")[2].partition('id="')[2].partition('"')[0]
            self.edges.append(f'<edge from-layer="{source}" from-port="{port}" to-layer="{number}" to-port="{place}"/>')
        self.shapes.append(shape)
        return number

    def parameter(self, name: str, *shape: int) -> int:
        """Add an input."""
        text = ",".join(map(str, shape))
        return self.layer("Parameter", shape=shape, name=name, element_type="f32", shape_=text)

    def constant(self, values: ArrayLike, kind: str = "float16") -> int:
        """Add a constant; of float16, one that is widened to float32."""
        array = np.asarray(values, kind)
        text = ", ".join(map(str, array.shape))
        offset, size = len(self.content), array.nbytes
        self.content += array.tobytes()
        number = self.layer(
            "Const", shape=array.shape, element_type=_TYPES[kind], shape_=text, offset=offset, size=size
        )
        return number if kind != "float16" else self.layer("Convert", number, shape=array.shape, destination_type="f32")

    def write(self, path: Path) -> tuple[Path, Path]:
        """Write the .xml file at a path and the .bin file beside it; return both paths."""
        layers, edges = "".join(self.layers), "".join(self.edges)
        path.write_text(f'<net name="small"><layers>{layers}</layers><edges>{edges}</edges></net>', encoding="utf-8")
        path.with_suffix(".bin").write_bytes(self.content)
        return path, path.with_suffix(".bin")


def _port(number: int, shape: Sequence[int], name: str | None = None) -> str:
    names = f" names={quoteattr(name)}" if name else ""
    return f'<port id="{number}"{names}>{"".join(f"<dim>{length}</dim>" for length in shape)}</port>'


def affine() -> Ir:
    """``scaled`` = 2 ``values`` + 1, of three numbers."""
    ir = Ir()
    doubled = ir.layer(
        "Multiply", ir.parameter("values", 1, 3), ir.constant([[2.0]]), shape=(1, 3), auto_broadcast="numpy"
    )
    scaled = ir.layer(
        "Add", doubled, ir.constant([[1.0, 1.0, 1.0]]), shape=(1, 3), name="scaled", auto_broadcast="numpy"
    )
    ir.layer("Result", scaled)
    return ir
