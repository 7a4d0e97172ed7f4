//! One bound UDP socket: its options, and datagrams out of it with the kernel's time and drop counter.

use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, SocketAddrV4, SocketAddrV6, UdpSocket};
use std::os::fd::{AsFd, AsRawFd, BorrowedFd};

use nix::libc;
use nix::sys::socket::sockopt::{self, GetStruct};
use nix::sys::socket::{
    AddressFamily, ControlMessageOwned, MsgFlags, SockFlag, SockType, SockaddrStorage, bind, getsockopt,
    recvmsg, setsockopt, socket,
};
use nix::sys::time::TimeSpec;

use super::buffer::Buffer;

/// Longest UDP payload there is (65,535 less nothing: IPv6 jumbograms are refused).
const LONGEST_PAYLOAD: usize = 65_535;

/// Opens, sets up and binds a socket: options first, so that the very first datagram has its kernel time.
pub(super) fn open(address: SocketAddr, receive_buffer_bytes: usize) -> io::Result<UdpSocket> {
    let family = if address.is_ipv4() { AddressFamily::Inet } else { AddressFamily::Inet6 };
    let flags = SockFlag::SOCK_NONBLOCK | SockFlag::SOCK_CLOEXEC;
    let descriptor = socket(family, SockType::Datagram, flags, None)?;
    setsockopt(&descriptor, sockopt::ReceiveTimestampns, &true)?;
    setsockopt(&descriptor, sockopt::RxqOvfl, &1)?;
    if address.is_ipv4() {
        setsockopt(&descriptor, sockopt::Ipv4PacketInfo, &true)?;
    } else {
        setsockopt(&descriptor, sockopt::Ipv6RecvPacketInfo, &true)?;
    }
    setsockopt(&descriptor, sockopt::RcvBuf, &receive_buffer_bytes)?;
    if granted_buffer_bytes(descriptor.as_fd())? < receive_buffer_bytes {
        // past net.core.rmem_max only with CAP_NET_ADMIN; without it the capped buffer stays and is reported
        let _ = setsockopt(&descriptor, sockopt::RcvBufForce, &receive_buffer_bytes);
    }
    bind(descriptor.as_raw_fd(), &SockaddrStorage::from(address))?;
    let bound = UdpSocket::from(descriptor);
    match address.ip() {
        IpAddr::V4(group) if group.is_multicast() => {
            bound.join_multicast_v4(&group, &Ipv4Addr::UNSPECIFIED)?
        }
        IpAddr::V6(group) if group.is_multicast() => bound.join_multicast_v6(&group, 0)?,
        _ => {}
    }
    Ok(bound)
}

/// Kernel buffer in the unit it was asked for: the kernel doubles the request for its bookkeeping (socket(7)).
pub(super) fn granted_buffer_bytes(descriptor: BorrowedFd<'_>) -> io::Result<usize> {
    Ok(getsockopt(&descriptor, sockopt::RcvBuf)? / 2)
}

/// What the kernel reports about one datagram.
#[derive(Clone, Copy, Debug)]
pub(super) struct Arrival {
    pub(super) source: SocketAddr,
    pub(super) destination: Option<IpAddr>,
    pub(super) time_ns: Option<u64>,
    /// Datagrams this socket has dropped since it was opened, modulo 2^32; absent while there are none.
    pub(super) dropped: Option<u32>,
}

/// Scratch space of one receiving task.
pub(super) struct Scratch {
    control: Vec<u8>,
    overflow: Vec<u8>,
}

impl Scratch {
    pub(super) fn new() -> Self {
        let control = nix::cmsg_space!(TimeSpec, u32, libc::in6_pktinfo);
        Self { control, overflow: vec![0; LONGEST_PAYLOAD] }
    }

    /// Reads one datagram into `buffer`. One longer than the buffer runs on into the overflow and the buffer grows:
    /// nothing is ever cut off, and the common datagram is copied once, by the kernel.
    pub(super) fn receive(&mut self, descriptor: BorrowedFd<'_>, buffer: &mut Buffer) -> io::Result<Arrival> {
        let room = buffer.held();
        let mut parts = [io::IoSliceMut::new(buffer.room()), io::IoSliceMut::new(&mut self.overflow)];
        let message = recvmsg::<SockaddrStorage>(
            descriptor.as_raw_fd(),
            &mut parts,
            Some(&mut self.control),
            MsgFlags::empty(),
        )?;
        let length = message.bytes;
        let mut arrival = Arrival {
            source: message.address.as_ref().and_then(socket_address).ok_or(io::ErrorKind::InvalidData)?,
            destination: None,
            time_ns: None,
            dropped: None,
        };
        for control in message.cmsgs()? {
            match control {
                ControlMessageOwned::ScmTimestampns(time) => arrival.time_ns = nanoseconds(time),
                ControlMessageOwned::RxqOvfl(count) => arrival.dropped = Some(count),
                ControlMessageOwned::Ipv4PacketInfo(info) => {
                    let address = Ipv4Addr::from(u32::from_be(info.ipi_addr.s_addr));
                    arrival.destination = Some(IpAddr::V4(address));
                }
                ControlMessageOwned::Ipv6PacketInfo(info) => {
                    arrival.destination = Some(IpAddr::from(info.ipi6_addr.s6_addr).to_canonical());
                }
                _ => {}
            }
        }
        buffer.fill(length, &self.overflow[..length.saturating_sub(room)]);
        Ok(arrival)
    }
}

/// Datagrams dropped since the socket was opened, modulo 2^32, whether or not a datagram followed them.
pub(super) fn dropped_so_far(descriptor: BorrowedFd<'_>) -> io::Result<u32> {
    Ok(getsockopt(&descriptor, MemoryInfo)?[SK_MEMINFO_DROPS])
}

/// `SO_MEMINFO` (linux/sock_diag.h): nine counters of which the last is the number of drops.
#[derive(Clone, Copy, Debug)]
struct MemoryInfo;

const SK_MEMINFO_DROPS: usize = 8;

nix::getsockopt_impl!(MemoryInfo, libc::SOL_SOCKET, libc::SO_MEMINFO, [u32; 9], GetStruct<[u32; 9]>);

fn socket_address(storage: &SockaddrStorage) -> Option<SocketAddr> {
    let address = match (storage.as_sockaddr_in(), storage.as_sockaddr_in6()) {
        (Some(v4), _) => SocketAddr::V4(SocketAddrV4::from(*v4)),
        (None, Some(v6)) => SocketAddr::V6(SocketAddrV6::from(*v6)),
        (None, None) => return None,
    };
    Some(SocketAddr::new(address.ip().to_canonical(), address.port()))
}

fn nanoseconds(time: TimeSpec) -> Option<u64> {
    let seconds = u64::try_from(time.tv_sec()).ok()?;
    Some(seconds * 1_000_000_000 + u64::try_from(time.tv_nsec()).ok()?)
}
