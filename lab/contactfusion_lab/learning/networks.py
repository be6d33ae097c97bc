"""The networks in torch: two LSTM layers and a read-out of the last step (O §II-D)."""

from collections.abc import Mapping
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from contactfusion.arrays import FloatArray
from contactfusion.generators.lstm import LAYERS, UNITS, Weights
from contactfusion.generators.networks import OUTPUTS, Scale
from contactfusion_lab.learning.backend import repeatable, torch
from contactfusion_lab.learning.dataset import WINDOW, Windows

Name = Literal["location", "type"]
"""Name of a network."""
KEENNESS = 6.0
"""Factor on torch's initial weights of the lengths: contact shows in the first centimetres of a
length, the first tenth of the range to which it is scaled."""
CHUNK = 4096
"""Windows that are predicted at a time."""


class ContactNetwork(torch.nn.Module):
    """One of the two networks.

    Args:
        name: of the network.
        columns: S, the proximity lengths of an instant.
        generator: draws the initial weights, uniform in ±1/√UNITS as torch does.
    """

    def __init__(self, name: Name, columns: int, generator: torch.Generator) -> None:
        super().__init__()
        self.lstm = torch.nn.LSTM(columns, UNITS, num_layers=LAYERS, batch_first=True)
        self.readout = torch.nn.Linear(UNITS, OUTPUTS[name])
        bound = UNITS**-0.5
        for tensor, parameter in self.named_parameters():
            widest = KEENNESS * bound if tensor == "lstm.weight_ih_l0" else bound
            torch.nn.init.uniform_(parameter, -widest, widest, generator=generator)

    def forward(self, windows: torch.Tensor) -> torch.Tensor:
        """The outputs, shape (b, outputs), for scaled windows, shape (b, WINDOW, S)."""
        hidden: torch.Tensor = self.lstm(windows)[0]
        outputs: torch.Tensor = self.readout(hidden[:, -1])
        return outputs


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
    network = ContactNetwork(name, windows.rows.shape[1], torch.Generator())
    put_weights(network, weights)
    with repeatable(), torch.no_grad():
        parts = [network(gathered(rows, chunk)) for chunk in starts.split(CHUNK)]
    outputs: FloatArray = torch.cat(parts).double().numpy()
    return outputs
