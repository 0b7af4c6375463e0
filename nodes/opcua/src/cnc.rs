//! Axes by their names, where a server follows OPC 40502 (CNC systems): the position of each is found by browsing.
//!
//! Place in the flow: when a session begins, for nodes that a launch file names like `opc40502:X`. The nodes are those of OPC 40502,
//! 1.00: a `CncInterface` with a `CncAxisList`, an axis with `PosDirect` (its own measuring system, the scale) and `PosIndirect` (that of
//! the motor), each with `ActPos` and `EngineeringUnits`. An interface is known by having a `CncAxisList`, so that types of a maker
//! pass. An axis that turns or was not referenced is refused.

use crate::node::{AxisName, Measures};
use crate::session::{Stop, value_of};
use opcua::client::Session;
use opcua::types::{
    BrowseDescription, BrowseDirection, BrowsePath, NodeClass, NodeId, ObjectId, QualifiedName, ReferenceDescription,
    ReferenceTypeId, RelativePath, RelativePathElement, TimestampsToReturn, UAString, Variant,
};
use std::collections::HashSet;

/// Namespace of the specification.
const NAMESPACE: &str = "http://opcfoundation.org/UA/CNC";
/// How many folders deep an interface is looked for, and among how many objects.
const DEEPEST: usize = 6;
const MOST_OBJECTS: usize = 2000;
/// Nodes in one question: servers have limits.
const AT_ONCE: usize = 100;

/// Where a position is read.
pub(crate) struct Position {
    /// The node of its value.
    pub(crate) value: NodeId,
    /// The property with its unit.
    pub(crate) unit: Option<NodeId>,
}

/// An object with the name that it has where it was found.
#[derive(Clone)]
struct Named {
    id: NodeId,
    name: String,
}

impl Named {
    fn of(reference: ReferenceDescription) -> Named {
        Named { id: reference.node_id.node_id, name: reference.browse_name.name.as_ref().to_owned() }
    }
}

/// Positions of axes at a server with these namespaces; of each, or why there is none, in words.
pub(crate) async fn positions(
    axes: &[&AxisName],
    namespaces: &[UAString],
    session: &Session,
) -> Result<Vec<Result<Position, String>>, Stop> {
    if axes.is_empty() {
        return Ok(Vec::new());
    }
    let number =
        namespaces.iter().position(|known| known.as_ref() == NAMESPACE).and_then(|place| place.try_into().ok());
    let Some(namespace) = number else {
        let problem = format!("the server has no namespace {NAMESPACE}: it does not follow OPC 40502; name the nodes");
        return Ok(axes.iter().map(|_| Err(problem.clone())).collect());
    };
    let interfaces = interfaces(namespace, session).await?;
    let mut found = Vec::with_capacity(axes.len());
    for axis in axes {
        found.push(match interface_of(axis, &interfaces) {
            Ok(list) => position(axis, list, namespace, session).await?,
            Err(problem) => Err(problem),
        });
    }
    Ok(found)
}

/// Interfaces below the folder of objects, each with its list of axes.
async fn interfaces(namespace: u16, session: &Session) -> Result<Vec<(String, NodeId)>, Stop> {
    let mut seen: HashSet<NodeId> = [ObjectId::Server.into()].into();
    let mut level = vec![Named { id: ObjectId::ObjectsFolder.into(), name: String::new() }];
    let mut found = Vec::new();
    for _ in 0..DEEPEST {
        let lists =
            targets(level.iter().map(|one| (&one.id, vec![(namespace, "CncAxisList")])).collect(), session).await?;
        let (mut below, mut open) = (Vec::new(), Vec::new());
        for (one, list) in level.into_iter().zip(lists) {
            match list {
                Some(list) => found.push((one.name, list)),
                None => open.push(one.id),
            }
        }
        for child in children(&open, session).await?.into_iter().flatten() {
            if seen.insert(child.id.clone()) && seen.len() <= MOST_OBJECTS {
                below.push(child);
            }
        }
        level = below;
        if level.is_empty() {
            break;
        }
    }
    Ok(found)
}

/// The list of axes that an axis is looked for in.
fn interface_of<'a>(axis: &AxisName, interfaces: &'a [(String, NodeId)]) -> Result<&'a NodeId, String> {
    let fits = |name: &str| axis.interface.as_ref().is_none_or(|wanted| wanted == name);
    let mut fitting = interfaces.iter().filter(|(name, _)| fits(name));
    match (fitting.next(), fitting.next()) {
        (Some((_, list)), None) => Ok(list),
        (None, _) if interfaces.is_empty() => {
            Err(format!("there is no CncAxisList among the first {MOST_OBJECTS} objects of the server; name the nodes"))
        }
        (None, _) => {
            Err(format!("no CNC interface has that name; there is {}", names(interfaces.iter().map(|(name, _)| name))))
        }
        (Some(_), Some(_)) => {
            let all = names(interfaces.iter().map(|(name, _)| name));
            Err(format!(
                "the server has several CNC interfaces that fit ({all}); write it like \"opc40502:INTERFACE/X\""
            ))
        }
    }
}

/// The position of an axis in a list of axes.
async fn position(
    axis: &AxisName,
    list: &NodeId,
    namespace: u16,
    session: &Session,
) -> Result<Result<Position, String>, Stop> {
    let all: Vec<Named> = children(std::slice::from_ref(list), session).await?.into_iter().flatten().collect();
    let mut fitting = all.iter().filter(|one| one.name == axis.axis);
    let own = match (fitting.next(), fitting.next()) {
        (Some(own), None) => &own.id,
        (None, _) => {
            return Ok(Err(format!(
                "there is no axis of that name; there is {}",
                names(all.iter().map(|one| &one.name))
            )));
        }
        (Some(_), Some(_)) => return Ok(Err("several axes have that name; name the node of ActPos".to_owned())),
    };
    let place = match axis.measures {
        Measures::Direct => "PosDirect",
        Measures::Indirect => "PosIndirect",
    };
    let paths = [
        vec![(namespace, place), (namespace, "ActPos")],
        vec![(namespace, place), (namespace, "EngineeringUnits")],
        vec![(namespace, place), (0, "EngineeringUnits")],
        vec![(namespace, "IsRotational")],
        vec![(namespace, "IsReferenced")],
    ];
    let found = targets(paths.into_iter().map(|path| (own, path)).collect(), session).await?;
    let [value, unit, plain_unit, turns, referenced] = <[_; 5]>::try_from(found).unwrap_or_default();
    let Some(value) = value else {
        let other = match axis.measures {
            Measures::Direct => "; where the motor's measuring system is the only one, write \"opc40502-indirect:\"",
            Measures::Indirect => "",
        };
        return Ok(Err(format!("the axis has no {place} with an ActPos{other}")));
    };
    if is(&turns, session).await? == Some(true) {
        return Ok(Err("the axis turns (IsRotational); axes here move along a line".to_owned()));
    }
    if is(&referenced, session).await? == Some(false) {
        return Ok(Err("the axis is not referenced (IsReferenced); home the machine".to_owned()));
    }
    Ok(Ok(Position { value, unit: unit.or(plain_unit) }))
}

/// What a node says that is true or false; `None` where it is not there or says neither.
async fn is(node: &Option<NodeId>, session: &Session) -> Result<Option<bool>, Stop> {
    let Some(node) = node else { return Ok(None) };
    let answer = session.read(&[value_of(node)], TimestampsToReturn::Neither, 0.0).await?;
    Ok(match answer.first().and_then(|answer| answer.value.as_ref()) {
        Some(Variant::Boolean(value)) => Some(*value),
        _ => None,
    })
}

/// Objects that each of these nodes has, by node.
async fn children(nodes: &[NodeId], session: &Session) -> Result<Vec<Vec<Named>>, Stop> {
    let question = |node: &NodeId| BrowseDescription {
        node_id: node.clone(),
        browse_direction: BrowseDirection::Forward,
        reference_type_id: ReferenceTypeId::HierarchicalReferences.into(),
        include_subtypes: true,
        node_class_mask: NodeClass::Object as u32,
        result_mask: 0x3f,
    };
    let mut all = Vec::with_capacity(nodes.len());
    for some in nodes.chunks(AT_ONCE) {
        let questions: Vec<BrowseDescription> = some.iter().map(question).collect();
        for answer in session.browse(&questions, 0, None).await? {
            let mut own: Vec<Named> = answer.references.into_iter().flatten().map(Named::of).collect();
            let mut more = answer.continuation_point;
            // A server that has no end of references is left at the most that is looked at.
            while !more.is_null_or_empty() && own.len() <= MOST_OBJECTS {
                let Some(next) = session.browse_next(false, &[more]).await?.into_iter().next() else { break };
                own.extend(next.references.into_iter().flatten().map(Named::of));
                more = next.continuation_point;
            }
            all.push(own);
        }
    }
    Ok(all)
}

/// Where paths from nodes lead; `None` of one that leads nowhere.
async fn targets(paths: Vec<(&NodeId, Vec<(u16, &str)>)>, session: &Session) -> Result<Vec<Option<NodeId>>, Stop> {
    let element = |(namespace, name): &(u16, &str)| RelativePathElement {
        reference_type_id: ReferenceTypeId::HierarchicalReferences.into(),
        is_inverse: false,
        include_subtypes: true,
        target_name: QualifiedName::new(*namespace, *name),
    };
    let path = |(node, names): &(&NodeId, Vec<(u16, &str)>)| BrowsePath {
        starting_node: (*node).clone(),
        relative_path: RelativePath { elements: Some(names.iter().map(element).collect()) },
    };
    let mut all = Vec::with_capacity(paths.len());
    for some in paths.chunks(AT_ONCE) {
        let questions: Vec<BrowsePath> = some.iter().map(path).collect();
        let answers = session.translate_browse_paths_to_node_ids(&questions).await?;
        let target = |k: usize| Some(answers.get(k)?.targets.as_ref()?.first()?.target_id.node_id.clone());
        all.extend((0..some.len()).map(target));
    }
    Ok(all)
}

fn names<'a>(all: impl Iterator<Item = &'a String>) -> String {
    let names: Vec<&str> = all.map(String::as_str).collect();
    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
}
