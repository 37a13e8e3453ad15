"""The course study: simulated users walk the figure along four stages with a pen and with a gamepad.

After the user test of Oshita 2005 (section 7.2), with simulated users in place of people.
"""
