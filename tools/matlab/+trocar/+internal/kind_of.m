function kind = kind_of(bridge, name)
    % Type of an arm, kind of another process; trocar:argument when there is none of this name.
    if ~isfield(bridge.instances, name)
        error('trocar:argument', 'there is no %s at %s; there are %s', name, bridge.at, ...
              strjoin(fieldnames(bridge.instances).', ', '));
    end
    kind = bridge.instances.(name);
end
