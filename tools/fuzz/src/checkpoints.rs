//! Corrects checksums: with a wrong one, a reader stops at once.

/// A checkpoint's bytes with corrected checksums of the sections and of the whole, as far as its lengths are valid.
pub fn sealed(data: &[u8]) -> Vec<u8> {
    let mut bytes = data.to_vec();
    let word = |bytes: &[u8], at: usize| bytes.get(at..at + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    let mut at = 16;
    for _ in 0..word(&bytes, 12).unwrap_or(0) {
        let Some(name) = word(&bytes, at) else { return bytes };
        let length = at + 4 + name as usize;
        let (Some(low), Some(high)) = (word(&bytes, length), word(&bytes, length + 4)) else { return bytes };
        let content = length + 12;
        let end = content.saturating_add((u64::from(high) << 32 | u64::from(low)) as usize);
        let Some(sum) = bytes.get(content..end).map(crc32fast::hash) else { return bytes };
        bytes[content - 4..content].copy_from_slice(&sum.to_le_bytes());
        at = end;
    }
    if at + 4 <= bytes.len() {
        let sum = crc32fast::hash(&bytes[..at]);
        bytes[at..at + 4].copy_from_slice(&sum.to_le_bytes());
    }
    bytes
}
