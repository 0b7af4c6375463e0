"""Trains the neighbourhood attention network in PyTorch; prints seconds an epoch, last validation loss and threads.

Place in the flow: rival of `network.rs`, which writes the file given as argument: single-precision numbers, sizes and
settings first (examples to learn from and to validate by, parameters, width, heads, epochs, batch, rate, decay), then
inputs and outputs of both sets and the first parameters, in the order of `abbe_residual_net::network::Layout`.
"""

import math
import sys
import time

import numpy as np
import torch
from torch import nn

VERTICES, TOKEN, OUTPUTS = 8, 6, 3


class Network(nn.Module):
    """Liang 2025, eq. 16-19: linear layer, multi-head self-attention, output layer."""

    def __init__(self, width, heads, values):
        super().__init__()
        self.width, self.heads = width, heads
        at = 0

        def take(*shape):
            nonlocal at
            size = math.prod(shape)
            block = torch.from_numpy(values[at : at + size].copy()).reshape(shape)
            at += size
            return block

        self.embedding = linear(take(TOKEN, width), take(width))
        self.query, self.key, self.value = (linear(take(width, width), None) for _ in range(3))
        self.mixing = linear(take(width, width), take(width))
        self.output = linear(take(VERTICES * width, OUTPUTS), take(OUTPUTS))
        assert at == values.size, "another layout of the parameters"

    def forward(self, inputs):
        batch = inputs.shape[0]
        x = self.embedding(inputs.reshape(batch, VERTICES, TOKEN))
        split = lambda y: y.reshape(batch, VERTICES, self.heads, -1).transpose(1, 2)
        z = nn.functional.scaled_dot_product_attention(*(split(f(x)) for f in (self.query, self.key, self.value)))
        z = self.mixing(z.transpose(1, 2).reshape(batch, VERTICES, self.width))
        return self.output(z.reshape(batch, -1))


def linear(weight, bias):
    layer = nn.Linear(weight.shape[0], weight.shape[1], bias=bias is not None)
    with torch.no_grad():
        layer.weight.copy_(weight.T)
        if bias is not None:
            layer.bias.copy_(bias)
    return layer


def main():
    data = np.fromfile(sys.argv[1], dtype=np.float32)
    learn, validate, parameters, width, heads, epochs, batch = (int(v) for v in data[:7])
    rate, decay = float(data[7]), float(data[8])
    at = 9

    def take(rows, columns):
        nonlocal at
        block = data[at : at + rows * columns].reshape(rows, columns)
        at += rows * columns
        return torch.from_numpy(block.copy())

    inputs, outputs = take(learn, VERTICES * TOKEN), take(learn, OUTPUTS)
    validation = take(validate, VERTICES * TOKEN), take(validate, OUTPUTS)
    network = Network(width, heads, data[at : at + parameters])
    optimiser = torch.optim.Adam(network.parameters(), lr=rate)
    schedule = torch.optim.lr_scheduler.ExponentialLR(optimiser, decay)
    loss_of = nn.MSELoss()
    torch.manual_seed(1)
    begin = time.perf_counter()
    for _ in range(epochs):
        order = torch.randperm(learn)
        for first in range(0, learn, batch):
            some = order[first : first + batch]
            optimiser.zero_grad()
            loss_of(network(inputs[some]), outputs[some]).backward()
            optimiser.step()
        schedule.step()
        with torch.no_grad():
            loss = loss_of(network(validation[0]), validation[1]).item()
    print((time.perf_counter() - begin) / epochs, loss, torch.get_num_threads())


if __name__ == "__main__":
    main()
