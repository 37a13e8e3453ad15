"""Recordings: MCAP files of the bodies as they came, which survive a killed recorder."""

from bunraku.runtime.bag.format import BagError, Channel, Entry, Header, TopicStats, header, shifted
from bunraku.runtime.bag.reader import Bag
from bunraku.runtime.bag.writer import BagWriter

__all__ = ["Bag", "BagError", "BagWriter", "Channel", "Entry", "Header", "TopicStats", "header", "shifted"]
