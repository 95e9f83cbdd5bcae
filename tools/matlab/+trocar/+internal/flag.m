function value = flag(on)
    % 1 or 0; not given: 1.
    value = double(logical(on));
end
