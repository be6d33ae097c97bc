"""Networks on sequences: layers, one on the other, and a read-out of the last (O §II-D)."""

from dataclasses import dataclass
from typing import Self, final

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.jit import kernel

LAYERS, UNITS = 2, 32
"""Layers of each network, and units of each layer."""
DENSE = "dense.0.weight"
"""A tensor that only a network of fully connected layers has."""

Weights = dict[str, NDArray[np.float32]]
"""The tensors of a network by their names in torch, such as `lstm.weight_ih_l0`."""


def tensor_shapes(columns: int, outputs: int) -> dict[str, tuple[int, ...]]:
    """Names and shapes of the weights, as in torch.

    Args:
        columns: S, the inputs of a time step.
        outputs: of the read-out.
    """
    shapes: dict[str, tuple[int, ...]] = {}
    for layer in range(LAYERS):
        inputs = UNITS if layer else columns
        shapes[f"lstm.weight_ih_l{layer}"] = (4 * UNITS, inputs)
        shapes[f"lstm.weight_hh_l{layer}"] = (4 * UNITS, UNITS)
        shapes[f"lstm.bias_ih_l{layer}"] = (4 * UNITS,)
        shapes[f"lstm.bias_hh_l{layer}"] = (4 * UNITS,)
    return shapes | {"readout.weight": (outputs, UNITS), "readout.bias": (outputs,)}


def dense_shapes(inputs: int, outputs: int) -> dict[str, tuple[int, ...]]:
    """Names and shapes of the weights of fully connected layers, as in torch.

    Args:
        inputs: all numbers of a sequence.
        outputs: of the read-out.
    """
    shapes: dict[str, tuple[int, ...]] = {}
    for layer in range(LAYERS):
        shapes[f"dense.{layer}.weight"] = (UNITS, UNITS if layer else inputs)
        shapes[f"dense.{layer}.bias"] = (UNITS,)
    return shapes | {"readout.weight": (outputs, UNITS), "readout.bias": (outputs,)}


@kernel
def lstm_layer(
    sequence: FloatArray, inputs: FloatArray, recurrent: FloatArray, bias: FloatArray
) -> FloatArray:
    """Hidden states of a layer of long short-term memory over a sequence, from a state of zeros.

    i, f, o = σ(W x + U h + b), g = tanh(W x + U h + b), c ← f c + i g, h ← o tanh c.

    Args:
        sequence: shape (n, k), x.
        inputs: shape (k, 4 u), W transposed: the columns of i, f, g and o.
        recurrent: shape (u, 4 u), U transposed.
        bias: shape (4 u,), b.

    Returns:
        Shape (n, u), h after each step.
    """
    units = len(recurrent)
    hidden = np.zeros((len(sequence) + 1, units))
    cell, gates = np.zeros(units), np.empty(4 * units)
    for step in range(len(sequence)):
        gates[:] = bias
        for row in range(len(inputs)):
            for gate in range(4 * units):  # in a loop: for `+=` of a row, numba allocates an array
                gates[gate] += sequence[step, row] * inputs[row, gate]
        for row in range(units):
            for gate in range(4 * units):
                gates[gate] += hidden[step, row] * recurrent[row, gate]
        for unit in range(units):
            let_in = 1.0 / (1.0 + np.exp(-gates[unit]))
            keep = 1.0 / (1.0 + np.exp(-gates[units + unit]))
            let_out = 1.0 / (1.0 + np.exp(-gates[3 * units + unit]))
            cell[unit] = keep * cell[unit] + let_in * np.tanh(gates[2 * units + unit])
            hidden[step + 1, unit] = let_out * np.tanh(cell[unit])
    return hidden[1:]


@final
@dataclass(frozen=True, slots=True, eq=False)
class Network:
    """A network of LSTM layers, laid out for the kernel.

    Attributes:
        layers: `inputs`, `recurrent` and `bias` of each layer, as `lstm_layer` takes them.
        readout: shape (outputs, UNITS).
        bias: shape (outputs,).
    """

    layers: tuple[tuple[FloatArray, FloatArray, FloatArray], ...]
    readout: FloatArray
    bias: FloatArray

    @classmethod
    def of(cls, weights: Weights) -> Self:
        """The network of weights named as in torch."""
        wide = {name: tensor.astype(np.float64) for name, tensor in weights.items()}
        layers = tuple(
            (
                np.ascontiguousarray(wide[f"lstm.weight_ih_l{layer}"].T),
                np.ascontiguousarray(wide[f"lstm.weight_hh_l{layer}"].T),
                wide[f"lstm.bias_ih_l{layer}"] + wide[f"lstm.bias_hh_l{layer}"],
            )
            for layer in range(LAYERS)
        )
        return cls(layers, wide["readout.weight"], wide["readout.bias"])

    def outputs(self, sequence: FloatArray) -> FloatArray:
        """Outputs after the last step, shape (outputs,), of a sequence of shape (n, S)."""
        for layer in self.layers:
            sequence = lstm_layer(sequence, *layer)
        result: FloatArray = self.readout @ sequence[-1] + self.bias
        return result


@final
@dataclass(frozen=True, slots=True, eq=False)
class DenseNetwork:
    """A network of fully connected layers, each cut off at 0, on all of a sequence at once.

    Attributes:
        layers: the weights, shape (UNITS, inputs), and the bias of each layer.
        readout: shape (outputs, UNITS).
        bias: shape (outputs,).
    """

    layers: tuple[tuple[FloatArray, FloatArray], ...]
    readout: FloatArray
    bias: FloatArray

    @classmethod
    def of(cls, weights: Weights) -> Self:
        """The network of weights named as in torch."""
        wide = {name: tensor.astype(np.float64) for name, tensor in weights.items()}
        layers = tuple(
            (wide[f"dense.{layer}.weight"], wide[f"dense.{layer}.bias"]) for layer in range(LAYERS)
        )
        return cls(layers, wide["readout.weight"], wide["readout.bias"])

    def outputs(self, sequence: FloatArray) -> FloatArray:
        """Outputs, shape (outputs,), for a sequence of shape (n, S)."""
        values: FloatArray = sequence.ravel()
        for weights, bias in self.layers:
            values = np.maximum(weights @ values + bias, 0.0)
        result: FloatArray = self.readout @ values + self.bias
        return result


def network_of(weights: Weights) -> Network | DenseNetwork:
    """The network of weights, of the layers that they are named after."""
    return DenseNetwork.of(weights) if DENSE in weights else Network.of(weights)
