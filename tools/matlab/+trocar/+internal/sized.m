function numbers = sized(values, count, what)
    % Numbers in a row; trocar:argument when they are not so many.
    if ~(isnumeric(values) || islogical(values)) || ~isreal(values) || numel(values) ~= count
        error('trocar:argument', '%s has %d numbers, not %d', what, count, numel(values));
    end
    numbers = double(values(:).');
end
