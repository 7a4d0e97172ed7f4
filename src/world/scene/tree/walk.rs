//! The walk, near boxes first, compiled once for each instruction set.
#![allow(unsafe_code)] // functions compiled for wider instructions are called after the processor was asked for them

use std::mem::MaybeUninit;

use super::build::{Corner, DEEPEST, Node, WIDTH};
use super::packet::Packet;
use crate::base::instructions::{Instructions, Level};

/// A subtree or a leaf that is still to be seen.
#[derive(Clone, Copy)]
struct Open {
    /// Distance at which the packet may enter it.
    enter: f32,
    first: u32,
    /// Triangles of a leaf; 0 for an inner node.
    count: u32,
    /// Rays that met its box, a bit each.
    rays: u32,
}

/// How the rays of a packet meet a triangle.
pub(super) trait Meet<const N: usize> {
    /// The `rays` that met the triangle's box meet it, or not.
    fn meet<const WIDE: bool>(&mut self, packet: &mut Packet<N>, corner: &Corner, place: u32, rays: u32);
}

/// In single precision, as the tree holds it.
pub(super) struct Rounded;

impl<const N: usize> Meet<N> for Rounded {
    #[inline(always)]
    fn meet<const WIDE: bool>(&mut self, packet: &mut Packet<N>, corner: &Corner, place: u32, rays: u32) {
        packet.meet_triangle::<WIDE>(corner, place, rays);
    }
}

/// Each node of a path leaves all its children but one behind.
const STACK: usize = DEEPEST * (WIDTH - 1) + 1;

/// Finds the nearest triangle of every element, or with `ANY` some triangle nearer than the element's limit.
pub(super) fn walk<const N: usize, const ANY: bool, M: Meet<N>>(
    nodes: &[Node],
    corners: &[Corner],
    reach_m: f32,
    packet: &mut Packet<N>,
    triangles: &mut M,
    instructions: Instructions,
) {
    match instructions.level() {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the level exists only where the processor has these instructions
        Level::Avx512 => unsafe { walk_avx512::<N, ANY, M>(nodes, corners, reach_m, packet, triangles) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the level exists only where the processor has these instructions
        Level::Avx2 => unsafe { walk_avx2::<N, ANY, M>(nodes, corners, reach_m, packet, triangles) },
        _ => walk_anywhere::<N, ANY, false, M>(nodes, corners, reach_m, packet, triangles),
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw")]
fn walk_avx512<const N: usize, const ANY: bool, M: Meet<N>>(
    nodes: &[Node],
    corners: &[Corner],
    reach_m: f32,
    packet: &mut Packet<N>,
    triangles: &mut M,
) {
    walk_anywhere::<N, ANY, true, M>(nodes, corners, reach_m, packet, triangles);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn walk_avx2<const N: usize, const ANY: bool, M: Meet<N>>(
    nodes: &[Node],
    corners: &[Corner],
    reach_m: f32,
    packet: &mut Packet<N>,
    triangles: &mut M,
) {
    walk_anywhere::<N, ANY, false, M>(nodes, corners, reach_m, packet, triangles);
}

/// `WIDE`: as compiled for AVX-512.
#[inline(always)]
fn walk_anywhere<const N: usize, const ANY: bool, const WIDE: bool, M: Meet<N>>(
    nodes: &[Node],
    corners: &[Corner],
    reach_m: f32,
    packet: &mut Packet<N>,
    triangles: &mut M,
) {
    packet.prepare(reach_m);
    // setting all of it up takes as long as a few nodes
    let mut stack = [const { MaybeUninit::<Open>::uninit() }; STACK];
    stack[0].write(Open { enter: 0.0, first: 0, count: 0, rays: u32::MAX });
    // SAFETY: everything below `height` was written
    let get = |stack: &[MaybeUninit<Open>; STACK], at: usize| unsafe { stack[at].assume_init() };
    let mut height = 1;
    while height > 0 {
        height -= 1;
        let open = get(&stack, height);
        if open.enter > packet.farthest {
            continue;
        }
        if open.count > 0 {
            let first = open.first as usize;
            let leaf = &corners[first..first + open.count as usize];
            for (place, corner) in (open.first..).zip(leaf) {
                triangles.meet::<WIDE>(packet, corner, place, open.rays);
            }
            if ANY && packet.all_won() {
                return;
            }
            packet.shorten();
            continue;
        }
        let node = &nodes[open.first as usize];
        let (enters, mut met) = packet.enters::<WIDE>(node);
        let bottom = height;
        while met != 0 {
            let side = met.trailing_zeros() as usize;
            met &= met - 1;
            let rays = packet.meets_box::<WIDE>(node, side);
            if rays == 0 {
                continue;
            }
            let enter = enters[side];
            let child = Open { enter, first: node.first[side], count: u32::from(node.count[side]), rays };
            fetch(nodes, corners, &child);
            // the nearest on top
            let mut at = height;
            while at > bottom && get(&stack, at - 1).enter < enter {
                stack[at] = stack[at - 1];
                at -= 1;
            }
            stack[at].write(child);
            height += 1;
        }
    }
}

/// Asks for memory that will be needed soon.
#[inline(always)]
fn fetch(nodes: &[Node], corners: &[Corner], open: &Open) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let line = |address: *const i8| {
            // SAFETY: a prefetch reads nothing, whatever the address
            unsafe { _mm_prefetch::<_MM_HINT_T0>(address) }
        };
        if open.count > 0 {
            let at = (&raw const corners[open.first as usize]).cast::<i8>();
            line(at);
            line(at.wrapping_add(64));
        } else {
            let at = (&raw const nodes[open.first as usize]).cast::<i8>();
            (0..4).for_each(|n| line(at.wrapping_add(64 * n)));
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (nodes, corners, open);
}
