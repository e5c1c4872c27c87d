"""Packs samples bit by bit, from the words of the formats' standards: slow, and with nothing of the driver's."""


def as_stream_of_bits(samples, bits):
    """PFNC "p": samples follow each other in a stream of bits, the lowest bit of the lowest byte first."""
    stream = sum(int(sample) << (bits * place) for place, sample in enumerate(samples))
    return stream.to_bytes(-(-bits * len(samples) // 8), "little")


def as_gvsp_packed(samples, bits):
    """GigE Vision "Packed": high eight bits, a byte with the low bits of two samples, high eight bits."""
    low = bits - 8
    out = bytearray()
    for place in range(0, len(samples), 2):
        pair = [int(sample) for sample in samples[place : place + 2]]
        first, second = pair[0], pair[1] if len(pair) == 2 else None
        shared = first & (2**low - 1)
        if second is not None:
            shared |= (second & (2**low - 1)) << 4
        out += bytes([first >> low, shared])
        if second is not None:
            out.append(second >> low)
    return bytes(out)


def as_csi_packed(samples, bits):
    """MIPI CSI-2: high eight bits of each sample of a group, then the low bits of all of them, the lowest first."""
    low = bits - 8
    size = {2: 4, 4: 2, 6: 4}[low]
    out = bytearray()
    for place in range(0, len(samples), size):
        group = [int(sample) for sample in samples[place : place + size]] + [0] * size
        out += bytes(sample >> low for sample in group[:size])
        rest = sum((sample & (2**low - 1)) << (low * index) for index, sample in enumerate(group[:size]))
        out += rest.to_bytes(low * size // 8, "little")
    return bytes(out)
