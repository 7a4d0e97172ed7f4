//! Packed streams: LZ4 frames one behind the other, and packed chunks and messages.

use std::io::{self, BufRead as _, BufReader, Read};

/// Longest message and chunk that is read; a cloud of 2048 x 128 points has 13 MB.
pub(crate) const MOST_MESSAGE_BYTES: usize = 256 << 20;

/// Unpacks LZ4 frames, as many as there are. One that is cut off is an error behind its last whole block.
pub(crate) struct Lz4Frames<R: Read> {
    decoder: Option<lz4::Decoder<BufReader<R>>>,
}

impl<R: Read> Lz4Frames<R> {
    pub fn new(read: R) -> io::Result<Self> {
        Ok(Self { decoder: Some(lz4::Decoder::new(BufReader::new(read))?) })
    }
}

impl<R: Read> Read for Lz4Frames<R> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        if into.is_empty() {
            return Ok(0);
        }
        while let Some(decoder) = &mut self.decoder {
            let count = decoder.read(into)?;
            if count > 0 {
                return Ok(count);
            }
            let Some((mut read, outcome)) = self.decoder.take().map(lz4::Decoder::finish) else { break };
            if outcome.is_err() {
                return Err(io::Error::new(io::ErrorKind::UnexpectedEof, "the LZ4 stream is cut off"));
            }
            if !read.fill_buf()?.is_empty() {
                self.decoder = Some(lz4::Decoder::new(read)?);
            }
        }
        Ok(0)
    }
}

/// How a chunk is packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Packing {
    None,
    Bz2,
    Lz4,
    Zstd,
}

/// Unpacks a chunk into `into`; what could be unpacked stays there where it ends in an error. No more than `most` bytes.
pub(super) fn unpack(packing: Packing, packed: impl Read, most: usize, into: &mut Vec<u8>) -> io::Result<()> {
    into.clear();
    let most = most as u64;
    match packing {
        Packing::None => packed.take(most).read_to_end(into),
        Packing::Bz2 => bzip2::read::MultiBzDecoder::new(packed).take(most).read_to_end(into),
        Packing::Lz4 => Lz4Frames::new(packed)?.take(most).read_to_end(into),
        Packing::Zstd => zstd::Decoder::new(packed)?.take(most).read_to_end(into),
    }
    .map(drop)
}

/// First bytes of a zstd frame.
pub(super) const ZSTD: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

/// Unpacks a message that is a zstd frame.
pub(super) fn unpack_zstd(packed: &[u8], into: &mut Vec<u8>) -> io::Result<()> {
    into.clear();
    let most = MOST_MESSAGE_BYTES as u64 + 1;
    zstd::Decoder::with_buffer(packed)?.take(most).read_to_end(into)?;
    if into.len() > MOST_MESSAGE_BYTES {
        into.clear();
        return Err(io::Error::new(io::ErrorKind::InvalidData, "it unpacks to more than 256 MiB"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;

    fn frame(content: &[u8]) -> Vec<u8> {
        let mut encoder = lz4::EncoderBuilder::new().build(Vec::new()).unwrap();
        encoder.write_all(content).unwrap();
        let (packed, outcome) = encoder.finish();
        outcome.unwrap();
        packed
    }

    #[test]
    fn joined_frames_are_one_stream_and_a_cut_one_is_an_error() {
        let long: Vec<u8> = (0..200_000_u32).flat_map(|at| at.wrapping_mul(at).to_le_bytes()).collect();
        let joined = [frame(b"one "), frame(b""), frame(&long)].concat();
        let mut content = Vec::new();
        Lz4Frames::new(&joined[..]).unwrap().read_to_end(&mut content).unwrap();
        assert_eq!(content, [b"one ", &long[..]].concat());
        content.clear();
        let cut = &joined[..joined.len() - 100];
        assert!(Lz4Frames::new(cut).unwrap().read_to_end(&mut content).is_err());
        assert!(content.len() > 4 && content.starts_with(b"one "));
    }
}
