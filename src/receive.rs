//! UDP sockets to packets, with every loss counted.
