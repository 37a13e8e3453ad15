"""The posing study: simulated users bring the figure into target poses by touch, and by a joint-handle editor.

After the user test of Oshita 2013 (section 7), with simulated users in place of people.
"""
