//! Several sensors on one port, and packets of none of them.

use std::path::PathBuf;

use sensors::Decoder;
use sensors::ouster::{Claim, OusterDecoder};

use super::{datagrams, metadata};
use crate::support::shared;

pub fn two_sensors_share_a_port() {
    for (capture, sizes) in [("same_ports", [16_640, 12_608]), ("same_ports_legacy", [24_896, 12_608])] {
        let path: PathBuf = shared(&format!("captures/ouster/{capture}.pcap"));
        let all = datagrams(&path);
        let [mut first, mut second] = [1, 2]
            .map(|number| OusterDecoder::new(metadata(&format!("captures/ouster/{capture}.{number}.json"))));
        let sources = sizes.map(|size| all.iter().find(|d| d.payload.len() == size).unwrap().source);
        assert_ne!(sources[0].ip(), sources[1].ip());
        let mut imu = [0, 0];
        // lidar packets first, so that each decoder knows where its sensor sits before the anonymous IMU packets
        let (lidar, rest): (Vec<_>, Vec<_>) = all.iter().partition(|datagram| datagram.payload.len() > 48);
        for datagram in lidar.into_iter().chain(rest) {
            let claims = [first.claim(&datagram.packet()), second.claim(&datagram.packet())];
            let mine = usize::from(claims[1] > claims[0]);
            assert_eq!(claims[1 - mine], Claim::No, "{capture}: {} B: {claims:?}", datagram.payload.len());
            assert_eq!(datagram.source.ip(), sources[mine].ip(), "{capture}: {claims:?}");
            let decoder = [&mut first, &mut second].into_iter().nth(mine).unwrap();
            decoder
                .push(&datagram.packet(), &mut |decoded| {
                    imu[mine] += usize::from(matches!(decoded, sensors::Decoded::Imu(_)))
                })
                .unwrap();
        }
        assert_eq!((first.stats().foreign, second.stats().foreign), (0, 0));
        assert_eq!(imu, if capture == "same_ports" { [1, 1] } else { [0, 0] });
    }
}

pub fn a_velodyne_look_alike_is_foreign() {
    let all = datagrams(&shared("captures/ouster/VLI-16-one-packet.pcap"));
    for description in ["OS-1-128_v2.3.0_1024x10", "ouster_example"] {
        let mut decoder = OusterDecoder::new(metadata(&format!("captures/ouster/{description}.json")));
        assert_eq!(decoder.claim(&all[0].packet()), Claim::No);
        let refused = decoder.push(&all[0].packet(), &mut |_| panic!("nothing is decoded")).unwrap_err();
        assert!(matches!(refused, sensors::Rejected::Foreign { .. }), "{refused}");
        assert_eq!(decoder.stats().foreign, 1);
    }
}
