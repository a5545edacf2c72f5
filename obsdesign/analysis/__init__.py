"""Can the sensors see the whole state?"""
