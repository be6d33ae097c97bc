"""The networks in torch: two layers of either design and a read-out (O §II-D)."""

from collections.abc import Mapping
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.generators.lstm import DENSE, LAYERS, UNITS, Weights
from contactfusion.generators.networks import OUTPUTS, Scale
from contactfusion_lab.learning.backend import repeatable, torch
from contactfusion_lab.learning.dataset import WINDOW, Windows

Name = Literal["location", "type"]
"""Name of a network."""
Design = Literal["lstm", "dense"]
"""Layers of a network: LSTM, or fully connected on all of a window."""
KEENNESS = 6.0
"""Factor on torch's initial weights of the lengths: contact shows in the first centimetres of a
length, the first tenth of the range to which it is scaled."""
CHUNK = 4096
"""Windows that are predicted at a time."""


class LstmNetwork(torch.nn.Module):
    """A network of two LSTM layers and a read-out of the last step.

    Args:
        columns: S, the proximity lengths of an instant.
        outputs: of the read-out.
    """

    def __init__(self, columns: int, outputs: int) -> None:
        super().__init__()
        self.lstm = torch.nn.LSTM(columns, UNITS, num_layers=LAYERS, batch_first=True)
        self.readout = torch.nn.Linear(UNITS, outputs)

    def forward(self, windows: torch.Tensor) -> torch.Tensor:
        """The outputs, shape (b, outputs), for scaled windows, shape (b, WINDOW, S)."""
        hidden: torch.Tensor = self.lstm(windows)[0]
        outputs: torch.Tensor = self.readout(hidden[:, -1])
        return outputs


class DenseNetwork(torch.nn.Module):
    """A network of two fully connected layers and a read-out.

    Args:
        columns: S, the proximity lengths of an instant.
        outputs: of the read-out.
    """

    def __init__(self, columns: int, outputs: int) -> None:
        super().__init__()
        inputs = [WINDOW * columns, *[UNITS] * (LAYERS - 1)]
        self.dense = torch.nn.ModuleList(torch.nn.Linear(count, UNITS) for count in inputs)
        self.readout = torch.nn.Linear(UNITS, outputs)

    def forward(self, windows: torch.Tensor) -> torch.Tensor:
        """The outputs, shape (b, outputs), for scaled windows, shape (b, WINDOW, S)."""
        values = windows.flatten(1)
        for layer in self.dense:
            values = torch.relu(layer(values))
        outputs: torch.Tensor = self.readout(values)
        return outputs


ContactNetwork = LstmNetwork | DenseNetwork
"""One of the networks."""
DESIGNS: Mapping[Design, type[ContactNetwork]] = {"lstm": LstmNetwork, "dense": DenseNetwork}


def drawn_network(
    name: Name,
    columns: int,
    generator: torch.Generator,
    design: Design = "lstm",
    keenness: float = KEENNESS,
) -> ContactNetwork:
    """A network with initial weights uniform in ±1/√inputs, for LSTM ±1/√UNITS, as torch's.

    Args:
        name: of the network.
        columns: S, the proximity lengths of an instant.
        generator: draws the weights.
        design: of its layers.
        keenness: factor on the weights of the lengths.
    """
    network = DESIGNS[design](columns, OUTPUTS[name])
    inputs = UNITS
    for tensor, parameter in network.named_parameters():
        if design == "dense" and tensor.endswith("weight"):
            inputs = parameter.shape[1]
        first = tensor in ("lstm.weight_ih_l0", DENSE)
        widest = inputs**-0.5 * (keenness if first else 1.0)
        torch.nn.init.uniform_(parameter, -widest, widest, generator=generator)
    return network


def weights_of(network: ContactNetwork) -> Weights:
    """A copy of the weights, by their names without the network's."""
    return {name: tensor.numpy().copy() for name, tensor in network.state_dict().items()}


def put_weights(network: ContactNetwork, weights: Mapping[str, NDArray[np.float32]]) -> None:
    """Replace the weights by others, as `weights_of` returns them.

    Raises:
        RuntimeError: they are those of another network.
    """
    network.load_state_dict({name: torch.tensor(array) for name, array in weights.items()})


def scaled_rows(windows: Windows, length: Scale) -> torch.Tensor:
    """The rows of windows as inputs of the networks, scaled, shape (m, S)."""
    return torch.from_numpy(length.scaled(windows.rows).astype(np.float32))


def gathered(rows: torch.Tensor, starts: torch.Tensor) -> torch.Tensor:
    """The windows that start at rows, shape (b, WINDOW, S)."""
    return rows[starts[:, None] + torch.arange(WINDOW)]


def predict(name: Name, weights: Weights, windows: Windows, length: Scale) -> FloatArray:
    """The outputs of a network for all windows, shape (w, outputs)."""
    rows, starts = scaled_rows(windows, length), torch.from_numpy(windows.starts)
    network = DESIGNS["dense" if DENSE in weights else "lstm"](windows.rows.shape[1], OUTPUTS[name])
    put_weights(network, weights)
    with repeatable(), torch.no_grad():
        parts = [network(gathered(rows, chunk)) for chunk in starts.split(CHUNK)]
    outputs: FloatArray = torch.cat(parts).double().numpy()
    return outputs
