#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes tiny.pth: a checkpoint of the published layout with a custom, tiny network.

It takes PyTorch 1.13, Debian's python3-torch.

Names carry the prefix of DataParallel; beside the parameters lie the states of an AdamW optimizer and of a one-cycle
scheduler, as a training script saves them. Element i of parameter number p is ((7 p + i) mod 251) / 251 - 0.5.

  python3 tests/data/make_tiny_pth.py tests/data/tiny.pth
"""
import sys
from collections import OrderedDict

import torch

CHANNELS, MID, FEATURES, BASE, LEVELS, RADIUS = (4, 4, 6, 8), 8, 8, 4, 2, 1


def shapes():
    yield "fnet.conv1", (CHANNELS[0], 3, 7, 7)
    before = CHANNELS[0]
    for layer, channels in enumerate(CHANNELS, 1):
        yield f"fnet.layer{layer}.0.conv1", (channels, before, 3, 3)
        yield f"fnet.layer{layer}.0.conv2", (channels, channels, 3, 3)
        if layer > 1:
            yield f"fnet.layer{layer}.0.downsample.0", (channels, before, 1, 1)
        yield f"fnet.layer{layer}.1.conv1", (channels, channels, 3, 3)
        yield f"fnet.layer{layer}.1.conv2", (channels, channels, 3, 3)
        before = channels
    yield "fnet.conv2", (MID, sum(CHANNELS), 3, 3)
    yield "fnet.conv3", (FEATURES, MID, 1, 1)
    inputs = 3 * LEVELS * (2 * RADIUS + 1) ** 2 + FEATURES + 2
    yield "delta_block.first_block_conv.conv", (BASE, inputs, 3)
    before = BASE
    for block in range(8):
        channels = BASE * 2 ** (block // 2)
        yield f"delta_block.basicblock_list.{block}.conv1.conv", (channels, before, 3)
        yield f"delta_block.basicblock_list.{block}.conv2.conv", (channels, channels, 3)
        before = channels
    yield "delta_block.dense", (2, before)
    yield "norm", (FEATURES,)


def formula(number, shape):
    count = torch.Size(shape).numel()
    return (((7 * number + torch.arange(count)) % 251).float() / 251 - 0.5).reshape(shape)


def main(path):
    state = OrderedDict()
    for name, shape in shapes():
        state[f"module.{name}.weight"] = formula(len(state), shape)
        state[f"module.{name}.bias"] = formula(len(state), shape[:1])
    state._metadata = OrderedDict({"": {"version": 1}})
    weight = torch.nn.Parameter(torch.zeros(3))
    optimizer = torch.optim.AdamW([weight], lr=5e-4)
    scheduler = torch.optim.lr_scheduler.OneCycleLR(
        optimizer, 5e-4, 200100, pct_start=0.05, cycle_momentum=False, anneal_strategy="linear")
    weight.sum().backward()
    optimizer.step()
    scheduler.step()
    torch.save({"optimizer_state_dict": optimizer.state_dict(), "model_state_dict": state,
                "scheduler_state_dict": scheduler.state_dict()}, path)


if __name__ == "__main__":
    main(sys.argv[1])
