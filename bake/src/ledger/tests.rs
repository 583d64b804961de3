use super::*;
use crate::blocks::FieldBlock;
use crate::error::ExactTile;

fn block(number: u32) -> DoneBlock {
    let bound = (0..20 + number as u8).collect();
    DoneBlock { number, block: FieldBlock { bound, tiles: Vec::new(), light: 0.1 }, exact: vec![ExactTile::default()] }
}

fn numbers_in(path: &Path, identity: u32, numbers: Range<u32>) -> Result<(Ledger, Vec<u32>), LedgerError> {
    let mut found = Vec::new();
    let ledger = Ledger::open(path, (identity, numbers), true, |block| {
        assert_eq!(block.block.bound.len() as u32, 20 + block.number);
        found.push(block.number);
    })?;
    Ok((ledger, found))
}

#[test]
fn blocks_come_back_and_more_can_follow() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.part");
    let mut ledger = Ledger::open(&path, (7, 3..6), false, |_| ()).unwrap();
    ledger.append(&block(3)).unwrap();
    ledger.append(&block(4)).unwrap();
    assert!(matches!(numbers_in(&path, 7, 3..6), Err(LedgerError::Busy(_))));
    drop(ledger);
    assert!(matches!(Ledger::open(&path, (7, 3..6), false, |_| ()), Err(LedgerError::There(_))));
    for other in [(8, 3..6), (7, 3..7)] {
        assert!(matches!(numbers_in(&path, other.0, other.1), Err(LedgerError::Other(_))));
    }
    let (mut ledger, found) = numbers_in(&path, 7, 3..6).unwrap();
    assert_eq!((found, ledger.next()), (vec![3, 4], 5));
    ledger.append(&block(5)).unwrap();
    drop(ledger);
    let file = File::open(&path).unwrap();
    let mut reader = Reader::new(&path, &file).unwrap();
    assert_eq!(std::iter::from_fn(|| reader.next_block()).map(|block| block.number).collect::<Vec<_>>(), [3, 4, 5]);
    reader.finish().unwrap();
}

/// Cut at any byte, or damaged at any, what is whole before is kept and the rest baked again.
#[test]
fn what_a_kill_leaves_is_cut_to_whole_blocks() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.part");
    let mut ledger = Ledger::open(&path, (7, 0..2), false, |_| ()).unwrap();
    ledger.append(&block(0)).unwrap();
    let first = ledger.file.stream_position().unwrap() as usize;
    ledger.append(&block(1)).unwrap();
    drop(ledger);
    let whole = std::fs::read(&path).unwrap();
    for length in first..whole.len() {
        std::fs::write(&path, &whole[..length]).unwrap();
        let (mut ledger, found) = numbers_in(&path, 7, 0..2).unwrap();
        assert_eq!(found, [0], "{length} bytes");
        ledger.append(&block(1)).unwrap();
        drop(ledger);
        assert_eq!(std::fs::read(&path).unwrap(), whole);
    }
    for at in first..whole.len() {
        let mut damaged = whole.clone();
        damaged[at] ^= 4;
        std::fs::write(&path, damaged).unwrap();
        let file = File::open(&path).unwrap();
        let mut reader = Reader::new(&path, &file).unwrap();
        assert_eq!(std::iter::from_fn(|| reader.next_block()).count(), 1, "byte {at}");
        assert!(matches!(reader.finish(), Err(LedgerError::Unfinished { done: 1, wanted: 2, .. })));
    }
}

#[test]
fn other_files_are_refused_and_kept() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.part");
    for text in ["a picture", "RELUME-BLOCKS 1 7 0", "RELUME-BLOCKS 1 7 3 3\n", "RELUME-BLOCKS 1 7 0 3", "\u{1}\u{2}"] {
        std::fs::write(&path, text).unwrap();
        assert!(matches!(numbers_in(&path, 7, 0..3), Err(LedgerError::Foreign(_))), "{text:?}");
        assert_eq!(std::fs::read_to_string(&path).unwrap(), text);
    }
}
